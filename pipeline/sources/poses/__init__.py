"""Where robots and sensors are, by the messages of a bag."""
