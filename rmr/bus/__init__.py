"""The bus between processes: the only place that knows zenoh, and the only one with sockets, threads and a clock.

It carries three kinds of traffic side by side: what the world does for the robots' bodies (`body`, `clock`,
`map`), the air (`radio` and `call`: the frames that robots send each other, whose fate is decided by `rmr.radio`), and
what operators read and ask (`truth`, `ops`, `alive`, `disturbances`). `keys` names them, `wire` spells the messages.
"""
