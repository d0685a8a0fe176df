//! The files that a mesh file names: material files, images, buffers.
//!
//! The readers of meshes decide what they read of them. Here a file counts as named where some part of a
//! statement that names files is a file's path: an option before a path, or spaces in one, are no matter.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::error::SceneError;
use crate::folder::Folder;
use crate::mesh::{MeshKind, unescaped};

/// The most bytes of a PLY file that are searched: its header stands there.
const LONGEST_HEADER: usize = 1 << 20;
/// The first bytes of a GLB, and where the text of its first chunk begins.
const GLB: (&[u8], usize) = (b"glTF", 20);
/// Words of a line that may stand before a path.
const MOST_WORDS: usize = 64;

/// The files in `folder` that the mesh file at `path` names, without those that are missing, sorted. Paths are
/// relative to the folder where `path` is.
///
/// # Errors
/// [`SceneError::Read`] where a file can't be read; [`SceneError::Outside`] where one lies elsewhere;
/// [`SceneError::Content`] for an extension that no mesh has.
pub fn named_files(folder: &Folder, path: impl AsRef<Path>) -> Result<Vec<PathBuf>, SceneError> {
    let path = path.as_ref();
    let kind = MeshKind::from_path(path)?;
    let bytes = folder.read(path)?;
    let parent = path.parent().unwrap_or(Path::new(""));
    let mut search = Search { folder, files: BTreeSet::new() };
    match kind {
        MeshKind::Obj => {
            for line in String::from_utf8_lossy(&bytes).lines() {
                if let Some(names) = line.trim().strip_prefix("mtllib") {
                    search.add_library(parent, names)?;
                }
            }
        }
        MeshKind::Ply => {
            let header = String::from_utf8_lossy(&bytes[..bytes.len().min(LONGEST_HEADER)]);
            let lines = header.lines().take_while(|line| line.trim() != "end_header");
            for line in lines {
                if let Some((_, name)) = line.split_once("TextureFile") {
                    search.add(parent, name)?;
                }
            }
        }
        MeshKind::Gltf => {
            for uri in uris(&bytes) {
                // Readers refuse what can't be unescaped.
                let name = unescaped(&uri).unwrap_or(uri.as_bytes().into());
                search.add(parent, &String::from_utf8_lossy(&name))?;
            }
        }
    }
    Ok(search.files.into_iter().collect())
}

struct Search<'f> {
    folder: &'f Folder,
    files: BTreeSet<PathBuf>,
}

impl Search<'_> {
    /// Adds the file called `name`; returns whether there is one.
    fn add(&mut self, parent: &Path, name: &str) -> Result<bool, SceneError> {
        let name = name.trim().trim_matches('"');
        if name.is_empty() {
            return Ok(false);
        }
        let path = parent.join(name.replace('\\', "/"));
        let is_file = match self.folder.find(&path) {
            Ok(path) => path.is_file(),
            Err(SceneError::Read { .. }) => false,
            Err(error) => return Err(error),
        };
        if is_file {
            self.files.insert(path);
        }
        Ok(is_file)
    }

    /// Adds the file that `text` names, perhaps before options; returns whether there is one.
    fn add_before_options(&mut self, parent: &Path, text: &str) -> Result<bool, SceneError> {
        let ends = text.match_indices(" -").map(|(start, _)| start).take(MOST_WORDS);
        for end in [text.len()].into_iter().chain(ends) {
            if self.add(parent, &text[..end])? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Adds a material file, or several, and the images that they name.
    fn add_library(&mut self, parent: &Path, names: &str) -> Result<(), SceneError> {
        let names = match self.add(parent, names)? {
            true => vec![names.trim().trim_matches('"')],
            false => names.split_whitespace().collect(),
        };
        for name in names {
            if !self.add(parent, name)? {
                continue;
            }
            let path = parent.join(name.replace('\\', "/"));
            let parent = path.parent().unwrap_or(Path::new(""));
            for line in String::from_utf8_lossy(&self.folder.read(&path)?).lines() {
                let mut left = line.trim();
                let keyword = left.split_whitespace().next().unwrap_or_default();
                let keyword = keyword.to_ascii_lowercase();
                if !(keyword.starts_with("map_") || ["norm", "bump", "disp"].contains(&&*keyword)) {
                    continue;
                }
                for _ in 0..MOST_WORDS {
                    let Some((_, rest)) = left.split_once(char::is_whitespace) else { break };
                    left = rest.trim_start();
                    if self.add_before_options(parent, left)? {
                        break;
                    }
                }
            }
        }
        Ok(())
    }
}

/// The URIs of buffers and images of a glTF file, but for those that have data.
fn uris(bytes: &[u8]) -> Vec<String> {
    let text = match bytes.strip_prefix(GLB.0) {
        Some(_) => {
            let length = bytes.get(12..16).and_then(|bytes| bytes.first_chunk());
            let length = length.map_or(0, |&length| u32::from_le_bytes(length) as usize);
            let end = GLB.1.saturating_add(length);
            bytes.get(GLB.1..end).unwrap_or_default()
        }
        None => bytes,
    };
    let Ok(root) = serde_json::from_slice::<Value>(text) else { return Vec::new() };
    let lists = ["buffers", "images"].map(|list| root[list].as_array().cloned());
    let uris = lists.iter().flatten().flatten().filter_map(|list| list["uri"].as_str());
    uris.filter(|uri| !uri.starts_with("data:")).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn named(files: &[(&str, &[u8])], path: &str) -> Result<Vec<String>, SceneError> {
        let directory = tempfile::tempdir().unwrap();
        for (name, bytes) in files {
            let file = directory.path().join(name);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, bytes).unwrap();
        }
        let folder = Folder::new(directory.path().join("scene")).unwrap();
        let found = named_files(&folder, path)?;
        Ok(found.iter().map(|path| path.to_string_lossy().replace('\\', "/")).collect())
    }

    #[test]
    fn an_obj_file_names_material_files_and_these_name_images() {
        let files: &[(&str, &[u8])] = &[
            ("scene/m/a.obj", b"mtllib \"sub/a b.mtl\"\nmtllib c.mtl d.mtl\n"),
            (
                "scene/m/sub/a b.mtl",
                b"newmtl x\nMAP_kd -s 1 1 1 -bm 2 my photo.png -o 1 -mm 0 1\nKd 1 1 1\n",
            ),
            ("scene/m/sub/my photo.png", b""),
            ("scene/m/d.mtl", b"\tmap_Pr  ..\\textures\\rough.png\nnorm gone.png\nmap_Ks\n"),
            ("scene/textures/rough.png", b""),
            ("scene/other.png", b""),
        ];
        let expected =
            ["m/../textures/rough.png", "m/d.mtl", "m/sub/a b.mtl", "m/sub/my photo.png"];
        assert_eq!(named(files, "m/a.obj").unwrap(), expected);
    }

    #[test]
    fn gltf_and_ply_files_name_theirs() {
        let text = br#"{"buffers":[{"uri":"a%20b.bin"},{"uri":"data:,x"}],"images":[{"uri":"t/c.png"},{}]}"#;
        let mut binary = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        binary.extend((text.len() as u32).to_le_bytes());
        binary.extend(b"JSON");
        binary.extend(text);
        let ply = b"ply\ncomment TextureFile my skin.png\nend_header\nTextureFile a b.bin\n";
        let files: &[(&str, &[u8])] = &[
            ("scene/a.gltf", text),
            ("scene/a.glb", &binary),
            ("scene/a.ply", ply),
            ("scene/a b.bin", b""),
            ("scene/t/c.png", b""),
            ("scene/my skin.png", b""),
        ];
        assert_eq!(named(files, "a.gltf").unwrap(), ["a b.bin", "t/c.png"]);
        assert_eq!(named(files, "a.glb").unwrap(), ["a b.bin", "t/c.png"]);
        assert_eq!(named(files, "a.ply").unwrap(), ["my skin.png"]);
    }

    #[test]
    fn files_elsewhere_are_refused_and_broken_files_name_none() {
        let secret: (&str, &[u8]) = ("secret.mtl", b"");
        for obj in [&b"mtllib ../secret.mtl\n"[..], b"mtllib no ../secret.mtl\n"] {
            let found = named(&[("scene/a.obj", obj), secret], "a.obj");
            assert!(matches!(found, Err(SceneError::Outside { .. })), "{found:?}");
        }
        let broken: &[&[u8]] =
            &[b"", b"glTF", b"glTF\x02\0\0\0\0\0\0\0\xff\xff\xff\xff", b"{", b"[]"];
        for bytes in broken {
            let files: &[(&str, &[u8])] = &[("scene/a.gltf", bytes)];
            assert_eq!(named(files, "a.gltf").unwrap(), [""; 0], "{bytes:?}");
        }
        assert!(matches!(named(&[("scene/a", b"")], "b.ply"), Err(SceneError::Read { .. })));
        assert!(matches!(named(&[("scene/a", b"")], "a.stl"), Err(SceneError::Content { .. })));
    }
}
