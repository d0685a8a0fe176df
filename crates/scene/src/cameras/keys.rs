//! The keys of a `transforms.json`: what is read, what says nothing of a camera, and what nobody knows.

use std::collections::{BTreeMap, BTreeSet};

use serde::de::IgnoredAny;

/// Keys that are read; `mask_path` is that of a frame.
const READ: &str = "camera_angle_x camera_angle_y camera_model cx cy file_path fl_x fl_y frames from_mitsuba from_na \
                    h is_fisheye k1 k2 k3 k4 k5 k6 latlong mask_path p1 p2 rolling_shutter transform_matrix w";

/// Keys that say nothing of a camera or of how an image stands for light: where the scene lies in its program's
/// own box, how that program works, what it found on its way, and other files. First NeRF's, then those of
/// instant-ngp and its scripts, then nerfstudio's.
const SILENT: [&str; 3] = [
    "rotation",
    "aabb aabb_scale depth_path enable_depth_loading enable_ray_loading importance_sampling integer_depth_scale \
     n_extra_learnable_dims n_frames offset render_aabb render_aabb_to_local scale sharpen sharpness \
     sharpness_discard_threshold up wants_importance_sampling",
    "applied_scale applied_transform auto_scale_poses_override center_method_override colmap_im_id depth_file_path \
     depth_unit_scale_factor motion_blur_score orientation_override ply_file_path",
];

/// Unknown keys that a note names.
const MOST_KEYS: usize = 12;

/// The keys of a file, or of a frame.
pub(super) type Keys = BTreeMap<String, IgnoredAny>;

/// Notes of the keys that nobody knows, of a file and of its frames.
///
/// # Errors
/// The rule, where there are keys of another lens.
pub(super) fn notes(file: &Keys, frames: &[Keys]) -> Result<Vec<String>, String> {
    let of_frames: BTreeSet<&str> =
        frames.iter().flat_map(BTreeMap::keys).map(String::as_str).collect();
    let all: BTreeSet<&str> = file.keys().map(String::as_str).collect();
    // instant-ngp's lens of five coefficients.
    if let Some(key) = all.union(&of_frames).find(|key| key.starts_with("ftheta_p")) {
        return Err(format!("a camera has a lens of OpenCV's, and {key} is of another"));
    }
    let unknown = |keys: &BTreeSet<&str>, whose: &str| {
        let is_known = |key: &str| {
            let known = SILENT.into_iter().chain([READ]).flat_map(str::split_whitespace);
            known.into_iter().any(|word| word == key)
        };
        let keys: Vec<_> = keys.iter().filter(|key| !is_known(key)).collect();
        let mut names: Vec<_> = keys.iter().take(MOST_KEYS).map(|key| format!("{key:?}")).collect();
        if let more @ 1.. = keys.len().saturating_sub(MOST_KEYS) {
            names.push(format!("{more} more"));
        }
        let note = format!("keys {whose} that are not known are left out: {}", names.join(", "));
        (!names.is_empty()).then_some(note)
    };
    let notes = [unknown(&all, "of the file"), unknown(&of_frames, "of frames")];
    Ok(notes.into_iter().flatten().collect())
}
