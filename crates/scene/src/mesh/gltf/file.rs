//! A glTF file that is being read: its parts, the bytes of its buffers, and what surrounds it.

use std::collections::HashMap;
use std::fmt::Display;
use std::path::PathBuf;
use std::rc::Rc;

use ::gltf::json::{Index, Root, buffer};

use super::budget::Budget;
use super::uri::{self, Target};
use crate::error::SceneError;
use crate::mesh::context::MeshContext;

/// A glTF file that is being read. Each of its buffers is read when it is first used.
#[derive(Debug)]
pub(super) struct GltfFile<'r, 'f> {
    pub(super) root: &'r Root,
    pub(super) context: &'r mut MeshContext<'f>,
    /// The second chunk of a GLB.
    chunk: Option<&'r [u8]>,
    buffers: Vec<Option<Rc<[u8]>>>,
    /// The bytes of files, by the path without links.
    files: HashMap<PathBuf, Rc<[u8]>>,
    /// By buffer, begin and end, the number of the image there.
    images: HashMap<[usize; 3], Option<usize>>,
    budget: Budget,
}

/// A part of a buffer, and how many bytes lie between the beginnings of two elements there, if that is said.
#[derive(Debug, Clone)]
pub(super) struct View {
    buffer: Rc<[u8]>,
    number: usize,
    begin: usize,
    end: usize,
    pub(super) stride: Option<usize>,
}

impl View {
    pub(super) fn bytes(&self) -> &[u8] {
        &self.buffer[self.begin..self.end]
    }
}

impl<'r, 'f> GltfFile<'r, 'f> {
    /// That of a file of so many `bytes`.
    pub(super) fn new(
        root: &'r Root,
        chunk: Option<&'r [u8]>,
        bytes: usize,
        context: &'r mut MeshContext<'f>,
    ) -> Self {
        let buffers = vec![None; root.buffers.len()];
        let (files, images) = (HashMap::new(), HashMap::new());
        Self { root, context, chunk, buffers, files, images, budget: Budget::new(bytes) }
    }

    /// An error of the file.
    pub(super) fn error(&self, message: impl Display) -> SceneError {
        self.context.error(message)
    }

    /// Notes what was left out or mended.
    pub(super) fn note(&mut self, text: impl Into<String>) {
        self.context.notes.add(text);
    }

    /// Refuses what takes more memory than is left: `count` parts of `bytes` each.
    pub(super) fn spend(&mut self, count: u64, bytes: usize) -> Result<(), SceneError> {
        self.budget.spend(count, bytes, &self.context.location())
    }

    /// The buffer with this number.
    fn buffer(&mut self, number: usize) -> Result<Rc<[u8]>, SceneError> {
        let Some(buffer) = self.root.buffers.get(number) else {
            let count = self.buffers.len();
            return Err(
                self.error(format!("the file has {count} buffers, and a view names {number}"))
            );
        };
        if let Some(bytes) = &self.buffers[number] {
            return Ok(bytes.clone());
        }
        let bytes: Rc<[u8]> = match (&buffer.uri, self.chunk) {
            (Some(uri), _) => match uri::target(uri).map_err(|rule| self.error(rule))? {
                Target::Data(bytes) => bytes.into(),
                Target::File(name) => self.file(&name)?,
            },
            (None, Some(chunk)) if number == 0 => chunk.into(),
            (None, _) => {
                let rule = "a buffer is the chunk of a GLB, or has a URI";
                return Err(self.error(format!("{rule}, and buffer {number} has neither")));
            }
        };
        let length = buffer.byte_length.0;
        if length > bytes.len() as u64 {
            let message = format!("buffer {number} has {} of {length}", bytes.len());
            return Err(self.error(format!("a buffer has the bytes that it says, and {message}")));
        }
        self.buffers[number] = Some(bytes.clone());
        Ok(bytes)
    }

    fn file(&mut self, name: &str) -> Result<Rc<[u8]>, SceneError> {
        let path = self.context.find(name)?;
        if let Some(bytes) = path.as_ref().and_then(|path| self.files.get(path)) {
            return Ok(bytes.clone());
        }
        // A missing file is an error here.
        let bytes: Rc<[u8]> = self.context.read(name)?.into();
        self.budget.earn(bytes.len());
        self.files.extend(path.map(|path| (path, bytes.clone())));
        Ok(bytes)
    }

    /// The buffer view with this number.
    pub(super) fn view(&mut self, index: Index<buffer::View>) -> Result<View, SceneError> {
        let (number, count) = (index.value(), self.root.buffer_views.len());
        let Some(view) = self.root.buffer_views.get(number) else {
            return Err(
                self.error(format!("the file has {count} buffer views, and one names {number}"))
            );
        };
        let buffer = self.buffer(view.buffer.value())?;
        let (begin, length) = (view.byte_offset.unwrap_or_default().0, view.byte_length.0);
        let end = begin.checked_add(length).filter(|&end| end <= buffer.len() as u64);
        let Some(end) = end else {
            let message = format!("view {number} has {length} from {begin} on of {}", buffer.len());
            return Err(self.error(format!("a buffer view has bytes of its buffer, and {message}")));
        };
        let (begin, end) = (begin as usize, end as usize);
        let stride = view.byte_stride.map(|stride| stride.0);
        Ok(View { buffer, number: view.buffer.value(), begin, end, stride })
    }

    /// The number of an image in the model; nothing where its file is missing or can't be read, which is noted.
    pub(super) fn image(&mut self, number: usize) -> Result<Option<usize>, SceneError> {
        let image = &self.root.images[number];
        let (location, name) = (self.context.location(), number.to_string());
        match (&image.uri, image.buffer_view) {
            (Some(uri), _) => match uri::target(uri).map_err(|rule| self.error(rule))? {
                Target::File(name) => self.context.image(&name),
                Target::Data(bytes) => self.context.decode(&bytes, &location, &name),
            },
            (None, Some(index)) => {
                let view = self.view(index)?;
                let key = [view.number, view.begin, view.end];
                if let Some(&known) = self.images.get(&key) {
                    return Ok(known);
                }
                self.budget.spend_image(view.bytes().len(), &location)?;
                let image = self.context.decode(view.bytes(), &location, &name)?;
                self.images.insert(key, image);
                Ok(image)
            }
            (None, None) => {
                let rule = "an image has a buffer view or a URI";
                Err(self.error(format!("{rule}, and image {number} has neither")))
            }
        }
    }
}
