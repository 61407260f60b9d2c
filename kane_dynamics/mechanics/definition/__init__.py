"""Kane's equations as the textbook defines them: the readable reference."""
