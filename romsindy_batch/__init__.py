"""Many records at once: an application beside the package, the command ``romsindy batch``."""
