"""A robot's passage of a shared resource: request, slot, entry, exit, and the link to the coordination core."""
