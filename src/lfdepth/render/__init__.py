"""What an estimate is used for: refocusing, seeing past an occluder, masks per view."""
