//! Where the mask of an image lies: in a folder of masks, under the image's name.
//!
//! # Source
//! Names of masks as COLMAP has them, `image.jpg.png`, and as most other programs do, `image.png`.

use std::ffi::OsString;
use std::path::{Component, Path, PathBuf};

use crate::folder::Folder;

/// The files in the folder `masks` that may be the mask of `image`, the first that is there is it.
///
/// The tree of masks is that of the images, or its lower part: of `images/front/1.jpg` first
/// `images/front/1`, then `front/1`, then `1`. Each may end as the image does, with `.png` in place of that,
/// or with `.png` after it.
fn names<'a>(masks: &'a Path, image: &Path) -> impl Iterator<Item = PathBuf> + use<'a> {
    let parts = image.components().filter_map(|part| match part {
        Component::Normal(name) => Some(name.to_owned()),
        _ => None,
    });
    let parts: Vec<OsString> = parts.collect();
    (0..parts.len()).flat_map(move |skipped| {
        let tail: PathBuf = parts[skipped..].iter().collect();
        let mut longer = tail.clone().into_os_string();
        longer.push(".png");
        [tail.clone(), tail.with_extension("png"), longer.into()].map(|name| masks.join(name))
    })
}

/// The mask of `image` in the folder `masks`, if there is one; all paths in `folder`.
pub fn find_mask(folder: &Folder, masks: &Path, image: &Path) -> Option<PathBuf> {
    let image = image.strip_prefix(folder.path()).unwrap_or(image);
    // A mask is no image of its own, where both lie in one folder.
    names(masks, image)
        .find(|name| name != image && folder.find(name).is_ok_and(|path| path.is_file()))
}

/// The name that the mask of `image` would have, for messages.
pub(crate) fn usual_mask(masks: &Path, image: &Path) -> PathBuf {
    masks.join(Path::new(image.file_name().unwrap_or_default()).with_extension("png"))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_mask_lies_where_its_image_does_in_the_other_tree() {
        let directory = tempfile::tempdir().unwrap();
        let folder = Folder::new(directory.path()).unwrap();
        let (masks, image) = (Path::new("masks"), Path::new("images/front/1.jpg"));
        // From the last choice to the first.
        let all = [
            "1.jpg.png",
            "1.png",
            "1.jpg",
            "front/1.jpg.png",
            "front/1.png",
            "front/1.jpg",
            "images/front/1.jpg.png",
            "images/front/1.png",
            "images/front/1.jpg",
        ];
        assert_eq!(find_mask(&folder, masks, image), None);
        fs::create_dir_all(directory.path().join("masks/images/front")).unwrap();
        fs::create_dir_all(directory.path().join("masks/front")).unwrap();
        for name in all {
            let path = masks.join(name);
            fs::write(directory.path().join(&path), "").unwrap();
            assert_eq!(find_mask(&folder, masks, image), Some(path));
        }
        let absolute = directory.path().join(image);
        assert_eq!(find_mask(&folder, masks, &absolute), Some(masks.join(all[8])));
        // Of an image of another folder it is the one that both share.
        assert_eq!(
            find_mask(&folder, masks, Path::new("images/2/1.jpg")),
            Some("masks/1.jpg".into())
        );
    }

    #[test]
    fn an_image_is_not_its_own_mask() {
        let directory = tempfile::tempdir().unwrap();
        let folder = Folder::new(directory.path()).unwrap();
        fs::write(directory.path().join("1.png"), "").unwrap();
        assert_eq!(find_mask(&folder, Path::new(""), Path::new("1.png")), None);
    }
}
