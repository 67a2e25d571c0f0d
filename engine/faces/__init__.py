"""What people and other programs call."""
