"""The corrected simulator: a robot in MuJoCo with the effects that a diagnosis identified."""
