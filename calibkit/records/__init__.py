"""What calibkit keeps: frames, coefficient files and run folders, sealed and written whole."""
