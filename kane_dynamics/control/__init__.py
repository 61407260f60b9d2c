"""Control laws: computed torque, gravity compensation, torque limits, collision detection."""
