"""Hosts for tests: network namespaces that hang on one switch by cables (veth pairs), made and removed by the test.

The switch is a namespace, too, so that nothing of the machine's own network is touched. The names hold the id of the
process that made them: what one that was killed has left is removed by the next.
"""

import os
import re
import shutil
import subprocess
from pathlib import Path

NAME = re.compile(r"rmr-(\d+)-\w+")
"""What a namespace of these tests is called: the process that made it, and the host."""


def not_permitted() -> str:
    """Return why this process cannot make hosts; empty where it can."""
    if shutil.which("ip") is None:
        return "there is no program ip (iproute2)"
    probe = f"rmr-{os.getpid()}-probe"
    done = subprocess.run(["ip", "netns", "add", probe], capture_output=True, text=True, check=False)
    if done.returncode:
        return f"no network namespaces: {done.stderr.strip()}"
    _remove({probe})
    return ""


def _ip(*words: str) -> str:
    return subprocess.run(["ip", *words], stdout=subprocess.PIPE, text=True, check=True).stdout


class Network:
    """Hosts named by letters; the n-th has the address 10.77.0.n, or another one."""

    def __init__(self, hosts: str, addresses: tuple[str, ...] = ()) -> None:
        """Make the hosts, with `addresses` in one network of 24 bits; what cannot be made leaves nothing."""
        self._hosts = hosts
        self._addresses = addresses or tuple(f"10.77.0.{number}" for number in range(1, len(hosts) + 1))
        _remove_stale()
        try:
            self._make()
        except BaseException:
            self.remove()
            raise

    def _make(self) -> None:
        switch = self._name("switch")
        _ip("netns", "add", switch)
        _ip("-n", switch, "link", "add", "bridge", "type", "bridge")
        _ip("-n", switch, "link", "set", "bridge", "up")
        for host in self._hosts:
            own = self._name(host)
            _ip("netns", "add", own)
            _ip("-n", switch, "link", "add", f"to-{host}", "type", "veth", "peer", "name", "cable", "netns", own)
            _ip("-n", switch, "link", "set", f"to-{host}", "master", "bridge", "up")
            _ip("-n", own, "address", "add", f"{self.address(host)}/24", "dev", "cable")
            for device in ("cable", "lo"):
                _ip("-n", own, "link", "set", device, "up")

    @staticmethod
    def _name(host: str) -> str:
        return f"rmr-{os.getpid()}-{host}"

    def address(self, host: str) -> str:
        """Return the address of `host`."""
        return self._addresses[self._hosts.index(host)]

    def on(self, host: str) -> list[str]:
        """Return the words before a command that is to run on `host`."""
        return ["ip", "netns", "exec", self._name(host)]

    def cut(self, host: str) -> None:
        """Pull the cable of `host`."""
        _ip("-n", self._name("switch"), "link", "set", f"to-{host}", "down")

    def heal(self, host: str) -> None:
        """Put the cable of `host` back."""
        _ip("-n", self._name("switch"), "link", "set", f"to-{host}", "up")

    def remove(self) -> None:
        """Remove all of it. May be called again."""
        _remove({self._name(host) for host in [*self._hosts, "switch"]})


def _namespaces() -> set[str]:
    return {line.split()[0] for line in _ip("netns", "list").splitlines() if line}


def _remove(names: set[str]) -> None:
    for name in sorted(names & _namespaces()):
        _ip("netns", "del", name)


def _remove_stale() -> None:
    made = ((name, NAME.fullmatch(name)) for name in _namespaces())
    _remove({name for name, match in made if match is not None and not Path(f"/proc/{match[1]}").exists()})
