"""Robots in MuJoCo: exact wrenches at given joint values, servo-driven motion, springs."""
