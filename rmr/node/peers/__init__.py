"""What a robot knows of the others: their hellos and who is where."""
