"""Why: provenance of facts, explanations of what is missing, and what the time of a missed deadline went into."""
