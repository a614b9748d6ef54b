"""A page to click: an application beside the package, the command ``romsindy app``."""
