"""The terminal: what is sent to it, how often, with which signs and colours. The only place with Textual's private names."""
