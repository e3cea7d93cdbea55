"""Package rmr.lang.lower: to be described here."""
