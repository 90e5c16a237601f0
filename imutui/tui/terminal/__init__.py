"""The terminal: what is sent to it, how often, in which signs and colours. Textual's private names are here only."""
