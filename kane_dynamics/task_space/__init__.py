"""Laws of control in the space of a frame: impedance, operational space, hand guiding."""
