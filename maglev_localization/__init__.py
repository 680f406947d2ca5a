"""Maglev train: induction loop, Doppler radar and balises fused along the guideway."""
