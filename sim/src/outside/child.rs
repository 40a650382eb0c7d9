//! The service as a process of its own.

use anyhow::{Context as _, bail};
use rustix::process::{Pid, Signal, kill_process};
use std::path::Path;
use std::process::{self, Command};

/// The running service. It is killed if the simulation ends before it.
#[derive(Debug)]
pub(super) struct Child(process::Child);

impl Child {
    /// Starts a command, with the configuration in place of `{config}`.
    pub(super) fn start(words: &[String], config: &Path) -> anyhow::Result<Self> {
        let config = config.to_str().context("the configuration's path is not UTF-8")?;
        let words: Vec<String> =
            words.iter().map(|word| word.replace("{config}", config)).collect();
        let (program, arguments) = words.split_first().context("no command")?;
        let child = Command::new(program).args(arguments).spawn();
        child.map(Self).with_context(|| format!("cannot start {program}"))
    }

    /// # Errors
    /// The service has ended by itself.
    pub(super) fn must_run(&mut self) -> anyhow::Result<()> {
        match self.0.try_wait()? {
            None => Ok(()),
            Some(status) => bail!("the service has ended by itself: {status}"),
        }
    }

    /// Asks it to end as systemd does, and tells how it did.
    pub(super) fn end(mut self) -> anyhow::Result<String> {
        if let Some(pid) = i32::try_from(self.0.id()).ok().and_then(Pid::from_raw) {
            kill_process(pid, Signal::TERM)?;
        }
        Ok(self.0.wait()?.to_string())
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        // One that has ended already cannot be killed, which is well.
        self.0.kill().ok();
        self.0.wait().ok();
    }
}
