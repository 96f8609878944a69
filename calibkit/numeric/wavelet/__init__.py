"""Lifting wavelets and denoising."""
