"""The robot's program at work: the machine and its rounds, deliveries of facts, facts from sensors."""
