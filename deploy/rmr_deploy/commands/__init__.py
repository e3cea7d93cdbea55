"""The options of this package's programs, a click command each; what is heavy is imported where it is needed."""
