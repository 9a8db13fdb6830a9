"""The signal that moves the arm for an identification, and how it is designed and played."""
