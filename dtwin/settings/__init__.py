"""What running controllers can be given, whatever arm they control."""
