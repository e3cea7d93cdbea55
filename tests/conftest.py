"""Makes the helpers that stand in this folder (`vm_hand`) importable from every test."""
