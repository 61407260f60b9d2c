"""The process torque_guard, which holds the arm when the dynamics node dies or hangs."""
