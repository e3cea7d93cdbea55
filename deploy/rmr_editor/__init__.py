"""`rmr lsp`: the compiler for editors, over the Language Server Protocol.

- `main`: the command. It says what to install where pygls is missing.
- `language_server`: the protocol, and what is said unasked; `answers`: the requests.
- `programs`: the texts that an editor holds, positions in them, and the compilation of each program.
- `symbols`: what a name is, where it is declared and used, and what may be written at a place.
- `highlight`: a lexer for Pygments.
- `vscode`: the extension for Visual Studio Code, which `rmr lsp --vsix` packs.

All that is said of a program comes from `rmr.lang`: there is no second analysis. docs/editor.md is the specification.
"""
