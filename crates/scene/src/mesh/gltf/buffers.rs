//! The bytes of buffers and buffer views.

use std::collections::HashMap;
use std::path::PathBuf;
use std::rc::Rc;

use ::gltf::json::{Index, Root, buffer};

use super::budget::Budget;
use super::uri::{self, Target};
use crate::error::SceneError;
use crate::mesh::context::MeshContext;

/// The buffers of a file. Each is read when it is first used.
#[derive(Debug)]
pub(super) struct Buffers<'r> {
    root: &'r Root,
    /// The second chunk of a GLB.
    chunk: Option<&'r [u8]>,
    read: Vec<Option<Rc<[u8]>>>,
    /// The bytes of files, by the path without links.
    files: HashMap<PathBuf, Rc<[u8]>>,
    /// By buffer, begin and end, the number of the image there.
    images: HashMap<[usize; 3], Option<usize>>,
    pub(super) budget: Budget,
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

impl<'r> Buffers<'r> {
    /// Those of a file of so many `bytes`.
    pub(super) fn new(root: &'r Root, chunk: Option<&'r [u8]>, bytes: usize) -> Self {
        let read = vec![None; root.buffers.len()];
        let (files, images) = (HashMap::new(), HashMap::new());
        let budget = Budget::of(bytes);
        Self { root, chunk, read, files, images, budget }
    }

    /// The buffer with this number.
    fn buffer(&mut self, number: usize, context: &MeshContext<'_>) -> Result<Rc<[u8]>, SceneError> {
        let refused = |found: String| SceneError::content(context.place(), found);
        let Some(buffer) = self.root.buffers.get(number) else {
            let count = self.read.len();
            return Err(refused(format!(
                "the file has {count} buffers, and a view names {number}"
            )));
        };
        if let Some(bytes) = &self.read[number] {
            return Ok(bytes.clone());
        }
        let bytes: Rc<[u8]> = match (&buffer.uri, self.chunk) {
            (Some(uri), _) => match uri::target(uri).map_err(&refused)? {
                Target::Data(bytes) => bytes.into(),
                Target::File(name) => self.file(&name, context)?,
            },
            (None, Some(chunk)) if number == 0 => chunk.into(),
            (None, _) => {
                let rule = "a buffer is the chunk of a GLB, or has a URI";
                return Err(refused(format!("{rule}, and buffer {number} has neither")));
            }
        };
        let length = buffer.byte_length.0;
        if length > bytes.len() as u64 {
            let found = format!("buffer {number} has {} of {length}", bytes.len());
            return Err(refused(format!("a buffer has the bytes that it says, and {found}")));
        }
        self.read[number] = Some(bytes.clone());
        Ok(bytes)
    }

    fn file(&mut self, name: &str, context: &MeshContext<'_>) -> Result<Rc<[u8]>, SceneError> {
        let path = context.find(name)?;
        if let Some(bytes) = path.as_ref().and_then(|path| self.files.get(path)) {
            return Ok(bytes.clone());
        }
        // A missing file is an error here.
        let bytes: Rc<[u8]> = context.read(name)?.into();
        self.budget.earn(bytes.len());
        self.files.extend(path.map(|path| (path, bytes.clone())));
        Ok(bytes)
    }

    /// The buffer view with this number.
    pub(super) fn view(
        &mut self,
        index: Index<buffer::View>,
        context: &MeshContext<'_>,
    ) -> Result<View, SceneError> {
        let refused = |found: String| SceneError::content(context.place(), found);
        let number = index.value();
        let Some(view) = self.root.buffer_views.get(number) else {
            let count = self.root.buffer_views.len();
            return Err(refused(format!(
                "the file has {count} buffer views, and one names {number}"
            )));
        };
        let buffer = self.buffer(view.buffer.value(), context)?;
        let (begin, length) = (view.byte_offset.unwrap_or_default().0, view.byte_length.0);
        let end = begin.checked_add(length).filter(|&end| end <= buffer.len() as u64);
        let Some(end) = end else {
            let found = format!("view {number} has {length} from {begin} on of {}", buffer.len());
            return Err(refused(format!("a buffer view has bytes of its buffer, and {found}")));
        };
        let (begin, end) = (begin as usize, end as usize);
        let stride = view.byte_stride.map(|stride| stride.0);
        Ok(View { buffer, number: view.buffer.value(), begin, end, stride })
    }

    /// The number of an image in the model; nothing where its file is missing or can't be read, which is noted.
    pub(super) fn image(
        &mut self,
        number: usize,
        context: &mut MeshContext<'_>,
    ) -> Result<Option<usize>, SceneError> {
        let image = &self.root.images[number];
        let place = context.place();
        let refused = |found: String| SceneError::content(place.clone(), found);
        let bytes = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => match uri::target(uri).map_err(&refused)? {
                Target::File(name) => return context.image(&name),
                Target::Data(bytes) => bytes,
            },
            (None, Some(index)) => {
                let view = self.view(index, context)?;
                let key = [view.number, view.begin, view.end];
                if let Some(&found) = self.images.get(&key) {
                    return Ok(found);
                }
                self.budget.spend_image(view.bytes().len(), &place)?;
                let found = context.decode(view.bytes(), &place, &number.to_string())?;
                self.images.insert(key, found);
                return Ok(found);
            }
            (None, None) => {
                let rule = "an image has a buffer view or a URI";
                return Err(refused(format!("{rule}, and image {number} has neither")));
            }
        };
        context.decode(&bytes, &place, &number.to_string())
    }
}
