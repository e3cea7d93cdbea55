"""New programs for running robots: distribution in fragments, verification, and a switch at one instant of lab time."""
