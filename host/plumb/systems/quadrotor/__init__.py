"""A quadrotor that flies: attitude, rates on three axes and four rotors."""
