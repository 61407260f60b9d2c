"""Models of mechanisms: bodies, joints, inertial properties, flexible links, and a builder."""
