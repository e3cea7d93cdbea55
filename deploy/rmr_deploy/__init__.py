"""A lab as processes: compile, start a world and its robots, watch them, stop them in order, report."""
