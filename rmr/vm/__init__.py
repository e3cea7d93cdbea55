"""The virtual machine of one robot: facts in, actions and facts for others out; the interpreter is the specification."""
