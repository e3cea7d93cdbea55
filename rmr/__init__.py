"""RMR: one logic program for a whole ensemble of robots, with deadlines that hold."""

__version__ = "0.1.0"
