"""Changes of the bodies, each settled before it is judged by the score."""
