"""What lets an acquisition run by itself: a unit of the user's systemd, and a udev rule for its serial adapter.

`user_unit` the unit, its settings, where they lie and whether systemd understands them · `udev_rule` the rule, for all
common adapters or for one · `usb_adapter` which adapter a port belongs to · `rule_syntax` whether udev would
understand a rule. The templates of both lie here. Nothing here starts, stops or installs a service.
"""
