"""Control laws, gravity compensation, torque limits, collision detection."""
