//! Entries to MCAP records.

use super::build_identity;
use super::entry::{Encoded, Written, encode};
use super::topic::{ConfigTwin, LostTwin, Topic};
use super::view::ViewTopic;
use crate::geometry::{Body, Lidar, Transform};
use crate::time::{Mono, Stamp};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions};
use std::collections::BTreeMap;
use std::io::{Seek, Write};

/// Uncompressed bytes in a chunk: about a second of flight.
pub(super) const CHUNK_BYTES: u64 = 512 * 1024;

/// What stands at the head of a log.
#[derive(Debug, Clone, PartialEq)]
pub struct LogHeader {
    /// When the log begins; viewers start their time line here.
    pub started_at: Stamp<Mono>,
    /// The effective configuration, TOML; a replay builds the brain from it.
    pub config_toml: String,
    /// Anything else worth knowing, such as civil time at the start.
    pub notes: BTreeMap<String, String>,
    /// How the LiDAR is mounted, by which viewers place its turns; `None` where there is none.
    pub body_from_lidar: Option<Transform<Body, Lidar>>,
}

impl LogHeader {
    /// The first message.
    pub(super) fn config(&self) -> serde_json::Result<Encoded> {
        let config = ConfigTwin {
            version: env!("CARGO_PKG_VERSION").into(),
            build: build_identity(),
            config_toml: self.config_toml.clone(),
        };
        encode(Topic::Config, &config)
    }
}

impl Default for LogHeader {
    fn default() -> Self {
        Self {
            started_at: Stamp::ZERO,
            config_toml: String::new(),
            notes: BTreeMap::new(),
            body_from_lidar: None,
        }
    }
}

/// Why an entry could not be written.
#[derive(Debug, thiserror::Error)]
pub(super) enum WriteError {
    #[error("{0}")]
    Mcap(#[from] McapError),
    #[error("{0}")]
    Json(#[from] serde_json::Error),
}

/// Writes one log.
pub(super) struct LogWriter<W: Write + Seek> {
    mcap: mcap::Writer<W>,
    channels: BTreeMap<Topic, u16>,
    views: BTreeMap<ViewTopic, u16>,
    sequence: u32,
}

impl<W: Write + Seek> LogWriter<W> {
    /// Begins a log: metadata, all channels with their schemas, and the configuration.
    pub(super) fn begin(to: W, header: &LogHeader) -> Result<Self, WriteError> {
        let mcap = WriteOptions::new()
            .profile("stockpilot")
            .library(concat!("stockpilot ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(CHUNK_BYTES))
            // Chunks are built in memory and appended whole: a kill never leaves a half-filled head.
            .disable_seeking(true)
            .create(to)?;
        let (channels, views) = (BTreeMap::new(), BTreeMap::new());
        let mut log = Self { mcap, channels, views, sequence: 0 };
        log.write_metadata(header)?;
        log.add_channels()?;
        log.write_encoded(header.started_at, &header.config()?)?;
        log.flush()?;
        Ok(log)
    }

    /// Writes an entry and what viewers see of it.
    pub(super) fn write(&mut self, at: Stamp<Mono>, written: &Written) -> Result<(), WriteError> {
        self.write_encoded(at, &written.encoded)?;
        for (topic, bytes) in &written.views {
            if let Some(channel) = self.views.get(topic).copied() {
                self.write_message(channel, at, bytes)?;
            }
        }
        Ok(())
    }

    /// Notes that entries are missing at this place.
    pub(super) fn write_lost(&mut self, at: Stamp<Mono>, n: u64) -> Result<(), WriteError> {
        self.write_encoded(at, &encode(Topic::Lost, &LostTwin { n_entries: n })?)
    }

    /// Adds to what is noted at the head.
    pub(super) fn write_notes(
        &mut self,
        metadata: BTreeMap<String, String>,
    ) -> Result<(), WriteError> {
        // Metadata stand between chunks.
        self.mcap.flush()?;
        Ok(self.mcap.write_metadata(&Metadata { name: "stockpilot".into(), metadata })?)
    }

    /// Closes the chunk, so that everything before is readable after a kill.
    pub(super) fn flush(&mut self) -> Result<(), WriteError> {
        Ok(self.mcap.flush()?)
    }

    /// Writes index and end, to the last byte.
    pub(super) fn finish(mut self) -> Result<(), WriteError> {
        self.mcap.finish()?;
        Ok(self.mcap.into_inner().flush().map_err(McapError::from)?)
    }

    fn write_metadata(&mut self, header: &LogHeader) -> Result<(), WriteError> {
        let mut metadata = header.notes.clone();
        metadata.insert("version".into(), env!("CARGO_PKG_VERSION").into());
        metadata.insert("build".into(), build_identity());
        metadata.insert("config_toml".into(), header.config_toml.clone());
        Ok(self.mcap.write_metadata(&Metadata { name: "stockpilot".into(), metadata })?)
    }

    fn add_channels(&mut self) -> Result<(), WriteError> {
        let none = BTreeMap::new();
        for topic in Topic::ALL {
            let schema = serde_json::to_vec(&topic.schema())?;
            let schema_id = self.mcap.add_schema(&topic.schema_name(), "jsonschema", &schema)?;
            let channel = self.mcap.add_channel(schema_id, topic.name(), "json", &none)?;
            self.channels.insert(*topic, channel);
        }
        for topic in ViewTopic::ALL {
            if let Some(schema) = topic.schema() {
                let schema_id =
                    self.mcap.add_schema(&schema.name, &schema.encoding, &schema.data)?;
                let channel = self.mcap.add_channel(schema_id, topic.name(), "protobuf", &none)?;
                self.views.insert(topic, channel);
            }
        }
        Ok(())
    }

    fn write_encoded(&mut self, at: Stamp<Mono>, message: &Encoded) -> Result<(), WriteError> {
        match self.channels.get(&message.topic) {
            Some(channel) => self.write_message(*channel, at, &message.json),
            None => Err(McapError::UnknownChannel(self.sequence, 0).into()),
        }
    }

    fn write_message(
        &mut self,
        channel_id: u16,
        at: Stamp<Mono>,
        bytes: &[u8],
    ) -> Result<(), WriteError> {
        let time = u64::try_from(at.nanos()).unwrap_or(0);
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        Ok(self.mcap.write_to_known_channel(&header, bytes)?)
    }
}
