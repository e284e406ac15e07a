"""What a controller raises."""


class ControllerError(ValueError):
    """No command can be computed from what was given; the text says why."""
