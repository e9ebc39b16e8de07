"""Pictures and clips without a display."""
