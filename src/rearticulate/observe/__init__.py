"""What the scans say by themselves: normals, registration, misfit, scale. In point spacings: see `frames`."""
