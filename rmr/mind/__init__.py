"""The log of a robot's inputs, and its replay: `RecordedNode` writes the log, `MindReplay` executes it again.

A node is values in, values out: it has no clock and no I/O. With its configuration and all of its inputs recorded,
everything else (facts, firings, routes, frames, wheel commands) is obtained by running it again.
"""
