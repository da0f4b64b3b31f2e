"""What a robot does with what it senses and hears."""
