"""Pictures of a scene: what it looks like, the forces on its bodies, and the page in which it moves."""
