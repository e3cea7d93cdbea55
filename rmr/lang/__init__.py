"""The compiler's front end: source text in, the program of one robot or diagnostics out. No robot carries it.

The packages are the phases, in this order:

- `read`: files to syntax trees, with recovery from syntax errors;
- `analyse`: names, types, constants, and warnings about the ensemble's program;
- `lower`: rules of the ensemble to rules of one robot, and those to byte-code;
- `diagnostics`: errors and warnings as data, and their rendering; `pages` has the page of each code;
- `format` and `explain`: `rmr fmt` and `rmr check --explain`.

`compiler` runs the phases, `checker` the checks between reading and byte-code; `fact_text` reads facts that arrive as
text. Other parts call these three.
"""
