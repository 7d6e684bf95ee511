"""Where a spot of the second colour lies on the first, and how well that is known."""

from pathlib import Path

import rotortrack as rt

mapping = rt.read_registration(Path("channels.json"))
with rt.open_movie(Path("sample_data") / "two_colours" / "movie.tif") as movie:
    camera = rt.Camera(offset_adu=100.0, gain_e_per_adu=1.5, read_noise_e=1.4)
    spots = rt.localise_all(movie, camera, pixel_size_nm=108.3)
x0, _, width, _ = mapping.regions[1]
second = spots[spots["x_nm"].between(x0 * 108.3, (x0 + width) * 108.3)]
places = mapping.to_first(second[["x_nm", "y_nm"]].to_numpy())
print(f"{len(places)} places, known to {mapping.error_nm(places).mean():.2f} nm a coordinate")
