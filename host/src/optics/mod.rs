//! Optics: from spectral radiance to spectral irradiance on the sensor grid.
