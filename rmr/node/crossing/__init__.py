"""A robot's use of shared resources: one state machine per crossing, its late policies, and what surrounds it."""
