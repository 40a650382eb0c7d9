//! What people ask for on the page.

use crate::messages::{Declaration, OperatorVerb};
use crate::mission::Phase;
use tokio::sync::oneshot;

/// What became of a wish.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WishAnswer {
    /// It is done or under way; false if it makes no sense now.
    pub is_accepted: bool,
    /// The mission's phase after it.
    pub phase: Phase,
}

/// One wish on its way to the mission.
#[derive(Debug)]
pub struct Wish {
    /// What is wanted.
    pub verb: OperatorVerb,
    /// What was said to it, if motors begin to turn.
    pub said: Option<Declaration>,
    reply: oneshot::Sender<WishAnswer>,
}

impl Wish {
    /// A wish, and where its answer arrives.
    #[must_use]
    pub fn new(
        verb: OperatorVerb,
        said: Option<Declaration>,
    ) -> (Self, oneshot::Receiver<WishAnswer>) {
        let (reply, answer) = oneshot::channel();
        (Self { verb, said, reply }, answer)
    }

    /// Answers; a person who has gone meanwhile does not hear it.
    pub fn answer(self, is_accepted: bool, phase: Phase) {
        if self.reply.send(WishAnswer { is_accepted, phase }).is_err() {
            tracing::debug!(is_accepted, "nobody waits for the answer any more");
        }
    }
}
