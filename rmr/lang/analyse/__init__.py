"""Package rmr.lang.analyse: to be described here."""
