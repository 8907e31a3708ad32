"""The panel: a page in the browser that shows and moves the robots of a running daemon, over its socket."""
