"""All robots of a program at once, as columns of numpy: what `rmr eval --engine columnar` and sweeps run.

A program that keeps at most one fact of each predicate on a robot (`rmr.analysis.column_obstacles` says whether) needs
no store and no search: a robot is a row, a predicate a column of bits that say whether it holds, each argument a column
of values. One step matches every rule against all rows, lets each row choose, and fires; a row does in it what its
machine would do in one firing, draw by draw (`rmr.vm` is the specification). Rows know nothing of each other, so they
are worked through in blocks that fit into a processor's cache.
"""
