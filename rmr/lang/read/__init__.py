"""Package rmr.lang.read: to be described here."""
