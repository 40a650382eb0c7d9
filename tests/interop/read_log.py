#!/usr/bin/env python3
"""Reads logs with the independent Python readers of MCAP and decodes every message.

Usage: read_log.py LOG...        (packages: requirements.txt; `run` installs them)

Lists the channels with their counts. Exits with 1 at the first message that cannot be decoded, does
not keep to its JSON schema, or stands out of order.
"""
import collections
import json
import sys

import jsonschema
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def read(path):
    counts = collections.Counter()
    validators = {}
    decode_protobuf = DecoderFactory().decoder_for
    last_sequence = -1
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for metadata in reader.iter_metadata():
            print(f"{path}: metadata {metadata.name}: {sorted(metadata.metadata)}")
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if message.sequence <= last_sequence:
                raise ValueError(f"sequence {message.sequence} after {last_sequence}")
            last_sequence = message.sequence
            if channel.message_encoding == "json":
                if channel.topic not in validators:
                    validators[channel.topic] = jsonschema.Draft202012Validator(
                        json.loads(schema.data))
                validators[channel.topic].validate(json.loads(message.data))
            else:
                decode_protobuf(channel.message_encoding, schema)(message.data)
            counts[channel.topic, channel.message_encoding, schema.name] += 1
    for (topic, encoding, schema), count in sorted(counts.items()):
        print(f"{count:8}  {topic:28} {encoding:9} {schema}")
    if not counts:
        raise ValueError("no messages")


def main():
    if len(sys.argv) < 2:
        print(__doc__, file=sys.stderr)
        return 2
    for path in sys.argv[1:]:
        try:
            read(path)
        except Exception as error:  # any reader's complaint is a failure of the file
            print(f"{path}: {type(error).__name__}: {error}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
