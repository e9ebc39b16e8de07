"""4D point clouds of any articulated object become rearticulable kinematic models."""
