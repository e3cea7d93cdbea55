"""Package rmr_world.validate: to be described here."""
