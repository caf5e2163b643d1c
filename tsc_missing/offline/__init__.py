"""Offline data: behaviour policies, episode logs, datasets and windows of them."""
