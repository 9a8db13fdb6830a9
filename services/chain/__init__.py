"""The services of a cell whose arm is another one than the thesis's: emulator, bridge and recorder."""
