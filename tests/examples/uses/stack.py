"""From a stack off an sCMOS camera to signed speeds with error bars."""

from pathlib import Path

import rotortrack as rt

SAMPLES = Path("sample_data")

with rt.open_movie(SAMPLES / "rotors" / "movie.tif") as movie:
    camera = rt.Camera(offset_adu=100.0, gain_e_per_adu=1.5, read_noise_e=1.4)
    spots = rt.localise_all(movie, camera, pixel_size_nm=108.3)
    frames = movie.shape[0]
found = rt.find_rotors(spots)
judged = rt.screen(found.localisations, found.rotors, n_frames=frames)
timing = {"frame_interval_s": 0.002}
tracks = rt.build_tracks(found.localisations, judged.rotors, gap_mode="drop", **timing)
motion = rt.measure_motion(tracks, judged.rotors, rt.MotionOptions(), exposure_s=0.002, **timing)
kept = motion.rotors[motion.rotors["verdict"] == "kept"]
print(kept[["rotor", "omega_rad_s", "omega_sd_rad_s", "diffusion_rad2_s", "behaviour"]])
