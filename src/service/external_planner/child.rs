//! One conversation with one process.

use rustix::process::{Pid, Signal, kill_process_group};
use std::process::{ExitStatus, Stdio};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWriteExt};
use tokio::process::Command;

/// An answer is never longer, bytes: room for ten thousand waypoints.
const MAX_ANSWER_BYTES: u64 = 1 << 20;
/// So much of what it says on stderr is kept for people, bytes.
const MAX_COMPLAINT_BYTES: u64 = 4096;
/// And so much of its last line is told, characters.
const MAX_TOLD_CHARS: usize = 160;

/// Gives the question, returns the whole answer. If the future is dropped, the process and all that it
/// started are killed.
pub(super) async fn converse(command: &[String], question: Vec<u8>) -> Result<Vec<u8>, String> {
    let Some((program, arguments)) = command.split_first() else {
        return Err("the command is empty".to_owned());
    };
    let mut child = Command::new(program)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0)
        .kill_on_drop(true)
        .spawn()
        .map_err(|error| format!("cannot start {program}: {error}"))?;
    let _group = Group::of(child.id());
    let (Some(to), Some(answers), Some(complaints)) =
        (child.stdin.take(), child.stdout.take(), child.stderr.take())
    else {
        return Err("no pipes to the program".to_owned());
    };
    // All three at once, or a full pipe on one would stop the others; a broken answer ends them all.
    let ((), complaint, answer) =
        tokio::try_join!(tell(to, question), listen(complaints), hear(answers))?;
    let status = child.wait().await.map_err(|error| format!("it cannot be waited for: {error}"))?;
    if status.success() { Ok(answer) } else { Err(failure(status, &complaint)) }
}

async fn tell(mut to: impl AsyncWriteExt + Unpin, question: Vec<u8>) -> Result<(), String> {
    // A program that does not listen is judged by its answer.
    drop(to.write_all(&question).await);
    Ok(())
}

async fn hear(answers: impl AsyncRead + Unpin) -> Result<Vec<u8>, String> {
    let mut answer = Vec::new();
    let n_read = answers.take(MAX_ANSWER_BYTES + 1).read_to_end(&mut answer).await;
    match n_read {
        Ok(n) if n as u64 > MAX_ANSWER_BYTES => {
            Err(format!("it says more than {MAX_ANSWER_BYTES} bytes"))
        }
        Ok(_) => Ok(answer),
        Err(error) => Err(format!("its answer cannot be read: {error}")),
    }
}

/// Keeps the beginning and lets the rest go by, so that the program never waits for us.
async fn listen(mut complaints: impl AsyncRead + Unpin) -> Result<Vec<u8>, String> {
    let mut kept = Vec::new();
    drop((&mut complaints).take(MAX_COMPLAINT_BYTES).read_to_end(&mut kept).await);
    drop(tokio::io::copy(&mut complaints, &mut tokio::io::sink()).await);
    Ok(kept)
}

fn failure(status: ExitStatus, complaint: &[u8]) -> String {
    let text = String::from_utf8_lossy(complaint);
    let last_line = text.lines().rev().find(|line| !line.trim().is_empty());
    let told: String = last_line
        .unwrap_or_default()
        .chars()
        .filter(|c| !c.is_control())
        .take(MAX_TOLD_CHARS)
        .collect();
    if told.is_empty() { format!("it ended with {status}") } else { format!("{status}: {told}") }
}

/// The process group of a program; killed at the end, whatever is left of it.
struct Group(Option<Pid>);

impl Group {
    fn of(child: Option<u32>) -> Self {
        Self(child.and_then(|id| i32::try_from(id).ok()).and_then(Pid::from_raw))
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        if let Some(leader) = self.0 {
            // An empty group is the usual case.
            let _was_empty = kill_process_group(leader, Signal::KILL).is_err();
        }
    }
}
