"""What acts at the joints of an emulated arm: encoders, drives, friction, and their faults."""
