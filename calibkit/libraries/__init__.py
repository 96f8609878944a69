"""What calibkit takes from other packages: optional libraries, plugins, templates, threads."""
