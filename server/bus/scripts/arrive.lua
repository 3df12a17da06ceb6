#!lua flags=allow-oom
-- KEYS: the engine, the grace, the era, the last server. ARGV: this engine, the one that this server knew or nothing, the server's number or
-- 0, milliseconds of grace. Returns the server's number; 0: it gets none during the grace.
--
-- The first to find another engine than before begins the grace. A server that comes later from another engine does so, too: what it has
-- may be missing here.
local known, former = redis.call('GET', KEYS[1]), ARGV[2]
if (known and known ~= ARGV[1]) or (former ~= '' and former ~= ARGV[1]) then
  if redis.call('SET', KEYS[2], '1', 'NX', 'PX', ARGV[4]) then redis.call('INCR', KEYS[3]) end
end
if known ~= ARGV[1] then redis.call('SET', KEYS[1], ARGV[1]) end
local number, last = tonumber(ARGV[3]), tonumber(redis.call('GET', KEYS[4]) or 0)
if number == 0 then
  if redis.call('EXISTS', KEYS[2]) == 1 then return 0 end  -- one that was lost might be given twice
  return redis.call('INCR', KEYS[4])
end
if last < number then redis.call('SET', KEYS[4], ARGV[3]) end
return number
