"""The columnar engine: all robots of a program at once, as numpy columns (`rmr eval --engine columnar`).

It runs programs that keep at most one fact of each predicate on a robot (`rmr.analysis.column_obstacles` decides). Such
a program needs no store and no search. A robot is a row. A predicate is a column of bits, which tell where it holds,
and a column of values for each argument. One step matches every rule against all rows, chooses a rule for each row, and
fires it. A row does in a step what its machine would do in one firing, with the same random draws (`rmr.vm` is the
specification). Rows are independent of each other, so they are processed in blocks that fit into a processor's cache.
"""
