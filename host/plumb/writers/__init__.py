"""Writers of logs and of the formats of other tools: files, pages, datagrams."""
