"""The language front end: source text in, a program for one robot or diagnostics out. No robot carries it."""
