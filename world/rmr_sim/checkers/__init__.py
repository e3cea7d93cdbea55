"""The rules that every simulated run must keep, checked while it runs.

A checker sees what no robot sees: all robots, the ground truth of the physics, and the faults. It subscribes to events
of the robots (`Simulation.subscribers`) and is called after each tick. It only observes: a run is the same with and
without it. Its memory is bounded, so that long runs cost no more than short ones.
"""
