#!lua flags=allow-oom
-- KEYS: the record, its epoch, all records. ARGV: the key, the epoch.
if redis.call('HGET', KEYS[1], 'epoch') == ARGV[2] then
  redis.call('DEL', KEYS[1])
  redis.call('ZREM', KEYS[3], ARGV[1])
  redis.call('PEXPIRE', KEYS[2], 86400000)
end
return 0
