"""What the monitor learns of a healthy arm at work, beside what its model lacks."""
