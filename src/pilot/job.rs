//! Long work that runs beside the brain and returns at a recorded place in the event order.

/// Long work: a pure function of what it holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Job {}

/// What a [`Job`] found.
#[derive(Debug, Clone, PartialEq)]
pub enum JobOutput {}

impl Job {
    /// Does the work. The same job gives the same bits on the same build.
    #[must_use]
    pub fn run(&self) -> JobOutput {
        match *self {}
    }
}
