"""Steps of an emulated serial arm without Python in between."""
