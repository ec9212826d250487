"""The shooting world: reset and step as pure functions, and how its engagements are drawn."""
