"""The first phase: source files to syntax trees.

Text, lexer, LALR(1) automaton, tree builder, included files. A syntax error is recovered from within its item: habits
of other languages are recognised first (`habits`), then single-token repairs are tried (`repair`).
"""
