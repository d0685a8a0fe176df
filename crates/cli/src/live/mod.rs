//! A page that shows a fit while it runs, from a small server in the program itself.
//!
//! The page shows progress, curves, views beside their targets, and the mesh. It asks about once a
//! second what is new, and loads pictures and the mesh when they changed. Nothing is written, and no
//! file is served.
//!
//! The server listens on 127.0.0.1 alone. A page of another site in the same browser learns nothing
//! from it: requests need a `Host` of this machine, and answers forbid other origins to use them.
//! Other users of this machine can see the page.

mod server;
mod snapshot;
mod state;
#[cfg(test)]
mod tests;

use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;

use server::Server;
use state::Shared;

pub use snapshot::{Ended, Snapshot, View};

/// A page that shows a fit while it runs. When it is dropped, its address answers no more.
#[derive(Debug)]
pub struct Live {
    shared: Arc<Shared>,
    server: Arc<Server>,
    thread: Option<JoinHandle<()>>,
}

impl Live {
    /// Serves the page on a port of 127.0.0.1; the system picks one for port 0. Until the first
    /// [`publish`](Self::publish) the page says that the fit has not begun.
    ///
    /// # Errors
    /// Those of the system: the port is taken or forbidden, or no thread can be started.
    pub fn start(port: u16) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        let shared = Arc::new(Shared::new());
        let server = Arc::new(Server::new(listener.local_addr()?));
        let thread = {
            let (shared, server) = (Arc::clone(&shared), Arc::clone(&server));
            let named = std::thread::Builder::new().name("live page".to_owned());
            named.spawn(move || server.serve(&listener, &shared))?
        };
        Ok(Self { shared, server, thread: Some(thread) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.server.address()
    }

    /// The page's address, for people and browsers.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address())
    }

    /// Shows a new state. It costs a comparison of the pictures and of the mesh with those before,
    /// and never waits for a browser.
    pub fn publish(&self, snapshot: Snapshot) {
        self.shared.publish(snapshot);
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        // A thread that could not be woken is left to the end of the program.
        if self.server.stop()
            && let Some(thread) = self.thread.take()
        {
            // Were it to have panicked, there would be nobody to tell.
            let _ = thread.join();
        }
    }
}
