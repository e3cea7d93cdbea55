"""Package rmr.lang.diagnostics: to be described here."""
