"""One robot: virtual machine, coordination, radio and motion joined behind the ports of `rmr.node.ports`."""
