"""What a program's actions do: the dispatcher, the built-in actions, handlers of users."""
