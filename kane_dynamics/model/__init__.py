"""Models of mechanisms: bodies, joints, inertias, flexible links, and a builder."""
