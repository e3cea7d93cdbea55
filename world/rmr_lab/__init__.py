"""Lab files for the people who write them: check, picture, schema, provided labs, a lab of one's own."""
