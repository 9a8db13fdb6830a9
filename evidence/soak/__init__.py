"""Long runs of a whole cell in real time: undisturbed, and under one trouble after the other."""
