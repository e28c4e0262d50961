"""The documentation site: its pages are the Markdown files of the project."""
