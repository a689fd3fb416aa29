"""Space resection: the camera's pose from targets of known place."""
