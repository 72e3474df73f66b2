"""More than one map: of every view, of many scenes, of fields larger than memory, of videos."""
