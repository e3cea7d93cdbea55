"""What every other package may know: time, values, geometry, named random streams."""
