"""What judges `quadrotor`."""
