"""`rmr lsp`: the compiler for editors, over the Language Server Protocol.

- `main`: the command. It says what to install where pygls is missing, which `language_server` alone imports.
- `language_server`: the protocol: requests and notifications of an editor to calls of the others.
- `programs`: the texts that an editor holds, positions in them, and the compilation of each program.

All that is said of a program comes from `rmr.lang`: there is no second analysis. docs/editor.md is the specification.
"""
