// Reads a log with @mcap/core and prints, as JSON, how many messages each topic has and the first of each, decoded.
import { open } from "node:fs/promises";
import { createRequire } from "node:module";

// packages lie beside the working folder, not beside this file
const require = createRequire(`${process.cwd()}/package.json`);
const { McapIndexedReader } = require("@mcap/core");
const { FileHandleReadable } = require("@mcap/nodejs");
const { loadDecompressHandlers } = require("@mcap/support");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");

const file = await open(process.argv[2]);
const reader = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(file),
  decompressHandlers: await loadDecompressHandlers(),
});
const text = new TextDecoder();
const readers = new Map();
const topics = {};
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  if (!readers.has(channel.id)) {
    const schema = reader.schemasById.get(channel.schemaId);
    readers.set(channel.id, new MessageReader(parse(text.decode(schema.data), { ros2: true })));
  }
  const decoded = readers.get(channel.id).readMessage(message.data);
  topics[channel.topic] ??= { count: 0, first: decoded };
  topics[channel.topic].count += 1;
}
const plain = (_, value) =>
  typeof value === "bigint" ? Number(value) : ArrayBuffer.isView(value) ? Array.from(value) : value;
console.log(JSON.stringify({ profile: reader.header.profile, topics }, plain));
await file.close();
