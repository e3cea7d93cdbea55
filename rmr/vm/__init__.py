"""The virtual machine of one robot; the interpreter is the executable specification (paper IV.B)."""
