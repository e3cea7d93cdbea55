"""What the compiler writes and every robot runs: the program's form, its octets, its verifier, its text."""
