"""Models of mechanisms: bodies, joints, inertial properties, flexible links, and their builder."""
