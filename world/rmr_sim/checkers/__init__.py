"""The rules that every simulated run must keep, each looked at while it runs.

A checker sees what no robot does: all of them, the truth of the physics, and what has gone wrong. It is told of what
happens inside the robots (`Simulation.hearers`) and called after each tick, but only looks: a run is the same with and
without it. It keeps little, so that long runs cost no more than short ones.
"""
